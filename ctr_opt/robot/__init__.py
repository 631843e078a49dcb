"""The robot and its actuation: frozen, validated values in plain numpy."""
