"""Playback: the straight chain follows the reversed record into its folded shape."""
