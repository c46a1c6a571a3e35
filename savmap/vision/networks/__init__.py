"""Networks by what their ONNX file is: an adapter for each layout, and onnxruntime's execution providers.

`segmenter.Segmenter` is what the rest of savmap uses; docs/networks.md says which files are taken.
"""
