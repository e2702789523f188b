"""From a picture, a camera and a rough pose to shape, pose and mask: the networks, their training, fits."""
