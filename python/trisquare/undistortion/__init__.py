"""Pictures without their distortion."""
