"""Link to a robot that sends its position as a line of text over TCP, and takes setpoints likewise."""
