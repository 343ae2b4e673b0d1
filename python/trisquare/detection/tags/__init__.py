"""Square markers: families, codes, decoding."""
