from geoident.api import CaseFile as CaseFile
from geoident.api import Found as Found
from geoident.api import ParameterEstimate as ParameterEstimate
from geoident.api import fit as fit
from geoident.api import load_case as load_case
from geoident.api import predict as predict
from geoident.api import sample as sample

__version__: str
