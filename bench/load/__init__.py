"""Load and faults: limits of the service under load, and faults that it must survive."""
