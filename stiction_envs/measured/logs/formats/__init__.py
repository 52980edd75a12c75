"""Files that hold joint logs: one kind in one file, and one line in `registry`."""
