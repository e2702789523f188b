"""How networks are trained: random pictures, losses, runs and their cards; no estimator needs it."""
