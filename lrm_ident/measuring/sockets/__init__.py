"""A printed or drilled board with conical sockets, in which an arm's tip is held."""
