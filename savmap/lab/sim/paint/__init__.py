"""A fast painter of labelled pictures: textured planar faces, a z-buffer over each face's region, one deferred shading
pass.

`stage` collects boxes, cylinders and polygons; `faces` lays them out as arrays; `raster` finds which face each pixel
sees; `shade` colours them from `atlas`; `develop` makes a photograph of it. It knows no structure.
"""
