"""The thesis's dithered torques, one physical statement after the other: nested models."""
