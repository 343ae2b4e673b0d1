"""The camera: its model, its JSON members, what may be asked of it, how well it projects."""
