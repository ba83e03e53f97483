"""Playback: the straight chain follows a record back into its folded state."""
