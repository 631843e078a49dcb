"""What the robot is and what is done to it: frozen, validated values in plain numpy."""
