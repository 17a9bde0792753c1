"""What of a foreign table is doubtful: it is said or asked for, not mended."""
