"""The dashboard: a browser page that shows the robots' images, maps and objects."""
