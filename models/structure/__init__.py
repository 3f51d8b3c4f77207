"""The structure: lengths, rigidity, form finding and mechanical properties, its rest shape, and estimated shapes."""
