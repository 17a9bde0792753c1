"""What rows and operating points of foreign tables make doubtful: it is said, not mended."""
