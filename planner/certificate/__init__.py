"""The certificate: what is verified of a motion, apart from the simulation that made it."""
