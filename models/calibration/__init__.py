"""How a sensor model is made of recordings of strips; no estimator imports this room."""
