"""How names, numbers and times are written in texts."""
