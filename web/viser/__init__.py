"""The 3D view: viser's client and its scenes, a preview's and a fold's, also as one file."""
