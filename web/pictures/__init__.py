"""Pictures: camera, colours, shapes of modules, and pictures without a browser."""
