"""What a calibration returns: frozen data, checked, exact through JSON and pickle."""
