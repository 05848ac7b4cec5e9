"""Run one episode in PyBullet: the world, the sensors, the scene, the executed grasp."""
