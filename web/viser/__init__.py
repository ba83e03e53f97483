"""3D view: viser's client, scenes of previews and folds, and pages that work without a server."""
