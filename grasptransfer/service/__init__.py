"""Grasp transfer as a service: requests over ZMQ in msgpack, answers with grasps, status and reasons.

`grasptransfer serve` keeps networks, renderer and grippers warm in one process. `client.py` needs pyzmq and
msgpack alone: copied beside a ROS node or into another Python, it reaches the service from there.
`server.py` says what a request and its answer hold.
"""
