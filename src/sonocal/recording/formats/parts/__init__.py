"""What several formats are made of: headers, fields of items, orientation, compressed frames, writers."""
