"""What pulls at the arm from outside: springs, cables, hoses; a cause per file."""
