"""What every room may use: checks of arguments, JSON members, files, numbers as text."""
