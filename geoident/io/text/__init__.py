"""Text files, positions and faults: what all readers of files share."""
