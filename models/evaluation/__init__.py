"""An estimate against the truth; no estimator imports this room."""
