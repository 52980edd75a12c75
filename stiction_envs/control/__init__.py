"""Control: what lies between a commanded torque and the joint."""
