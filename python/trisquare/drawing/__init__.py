"""Drawing on photographs: overlays, detections, difference maps."""
