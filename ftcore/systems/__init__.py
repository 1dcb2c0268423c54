"""FTLab."""
