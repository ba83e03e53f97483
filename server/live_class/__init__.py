"""Live classes: the view of a leader, shared with followers."""
