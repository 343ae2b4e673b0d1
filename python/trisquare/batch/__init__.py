"""Many cameras, each from its own photographs: found, calibrated, stored and summed up."""
