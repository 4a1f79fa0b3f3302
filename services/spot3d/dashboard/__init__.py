"""The dashboard: a page in the browser that shows what robots see and find."""
