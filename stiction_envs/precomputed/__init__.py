"""Results that take seconds to make and follow from their inputs alone: looked up, else made."""
