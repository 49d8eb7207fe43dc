"""The manual: how the pages of ``geoident/docs`` are renewed, checked and made a site."""
