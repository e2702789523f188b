"""Category folders from the parametric shapes of `workshop.objects`, whose correspondences are exact."""
