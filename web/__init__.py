"""Web: pictures, movies, 3D views and scripts that show folds."""
