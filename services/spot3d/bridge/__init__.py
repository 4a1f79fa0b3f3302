"""The way over a thin link: joins a robot's router with the ground's, without ever making the robot wait."""
