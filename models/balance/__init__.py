"""The balance of forces: tendons, gravity and floor, what rods and cables take of them, and the loads left over."""
