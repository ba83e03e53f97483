"""Twist chains: codes of Rubik's snakes and snake cubes, and their exact geometry."""
