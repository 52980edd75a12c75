"""What a log says otherwise than the arm: offsets, gains, delays; a cause per file."""
