"""The world: planets, vehicles, atmosphere, equations of motion."""
