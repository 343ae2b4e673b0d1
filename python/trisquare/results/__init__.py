"""Results of a calibration: frozen data, checked, exact through JSON and pickle."""
