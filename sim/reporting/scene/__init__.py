"""Scene of a run as stills and clips: camera, water, marks and text, with and without OpenGL."""
