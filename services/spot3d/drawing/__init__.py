"""Pictures drawn with OpenCV: views with boxes, the scene from above, charts."""
