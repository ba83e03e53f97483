"""Confinement: what the kernel lets a computing process touch, once it reads strangers' bytes."""
