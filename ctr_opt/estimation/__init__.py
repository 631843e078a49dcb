"""What estimates of every kind share: measurements, experiments, models with derivatives, losses."""
