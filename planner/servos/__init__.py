"""Servos: those that makers publish, materials of modules, and servos that suit a torque."""
