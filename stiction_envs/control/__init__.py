"""Control: controllers, and the path of a commanded torque to the joint."""
