"""Calibrations: from what a sensor gives, such as the frequency of a vibrating wire, to a reading.

The strain of a wire goes with the square of its frequency f, which data sheets count in *digits*,
f^2/1000 with f in Hz (linear digits, B units). With R in digits, R0 the zero reading, and T the
temperature of the sensor, the sheets give

    reading = G (R0 - R)  or  G (R - R0)  or  a polynomial in R, plus K (T - T0).
"""

from __future__ import annotations

from dataclasses import dataclass

RAW = {
    "hz": "Hz",
    "digits": "digits",
    "digit": "digits",
    "dg": "digits",
    "hz2/1000": "digits",
    "mv/v": "mV/V",
    "mv": "mV",
    "v": "V",
    "ma": "mA",
    "ohm": "Ohm",
}
"""What sensors give, in small letters, to how it is called here."""
RAW_UNITS = tuple(dict.fromkeys(RAW.values()))


def raw_unit(text: str) -> str | None:
    """What a sensor gives; None for a unit of readings.

    >>> raw_unit("Digits"), raw_unit("Hz²/1000"), raw_unit("kPa")
    ('digits', 'digits', None)
    """
    return RAW.get(text.strip().lower().replace(" ", "").replace("²", "2").replace("^", ""))


@dataclass(frozen=True)
class Calibration:
    """Of one sensor.

    Args:
        reads: what the sensor gives, one of `RAW_UNITS`; R is f^2/1000 for Hz, else the number.
        coefficients: c0, c1, ... of the polynomial in R that gives the reading, SI per power of R.
        zero: what the sensor gave at its zero, in the unit of ``reads``: the polynomial of it is
            subtracted; None where nothing is.
        thermal: what the reading gains per degree above ``zero_temperature``, SI.
        zero_temperature: degrees Celsius.
        temperature: name of the column that has the temperature; empty for none.
    """

    reads: str
    coefficients: tuple[float, ...]
    zero: float | None = None
    thermal: float = 0.0
    zero_temperature: float = 0.0
    temperature: str = ""

    def reading(self, number: float, temperature: float | None = None) -> float:
        """The reading, SI.

        Args:
            number: what the sensor gave, in the unit of ``reads``.
            temperature: degrees Celsius; None if it is not known.

        >>> Calibration("Hz", (0.0, -100.0), zero=3000.0).reading(2900.0)
        59000.0
        """
        value = self._polynomial(self._linear(number))
        if self.zero is not None:
            value -= self._polynomial(self._linear(self.zero))
        if self.thermal and temperature is not None:
            value += self.thermal * (temperature - self.zero_temperature)
        return value

    def slope(self, number: float) -> float:
        """Derivative of the reading by what the sensor gives, SI per its unit."""
        r = self._linear(number)
        slope = sum(n * c * r ** (n - 1) for n, c in enumerate(self.coefficients) if n)
        return slope * (2e-3 * number if self.reads == "Hz" else 1.0)

    def _linear(self, number: float) -> float:
        return number**2 / 1e3 if self.reads == "Hz" else number

    def _polynomial(self, r: float) -> float:
        return sum(c * r**n for n, c in enumerate(self.coefficients))
