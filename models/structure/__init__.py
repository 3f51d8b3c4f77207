"""The structure: its lengths, rigidity and mechanical properties, its rest shape, and estimated shapes with loads."""
