"""Pictures: the camera, colours, the modules as they are drawn, and pictures without a browser."""
