"""The published algorithm on the Open Dynamics Engine (ODE), the physics engine of the paper."""
