"""The process around a core: Zenoh sessions, topics, joins, credit and health."""
