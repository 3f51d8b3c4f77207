"""The structure: its lengths, rigidity, balance of forces, loads, rest shape and estimated shapes."""
