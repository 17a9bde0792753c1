"""What rows and operating points of foreign tables say against themselves; it is said, not mended."""
