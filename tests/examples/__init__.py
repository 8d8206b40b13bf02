"""What the examples show is so."""
