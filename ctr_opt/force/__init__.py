"""Force from shape: the loads on a robot from measurements of it."""
