"""What only reproduces the thesis: nested models of its tables, its figures, its pages."""
