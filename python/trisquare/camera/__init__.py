"""The camera: its model, settings, JSON members, and projection with its uncertainty."""
