"""What the operator's side sees of the controller."""
