"""For robots: motions made smoother, times that joints can keep, trajectories and motors."""
