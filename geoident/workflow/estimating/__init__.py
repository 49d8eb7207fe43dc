"""From readings to parameters and what is known of them: the fit, its errors, its predictions."""
