"""InternData-N1's VLN-PE layout: LeRobot v2.1 with frames as .npy, as InternNav's loaders read it.

The layout as seen in InternRobotics/InternNav: internnav/utils/lerobot_as_lmdb.py reads the files,
internnav/dataset/{base,cma_lerobot_dataset,rdp_lerobot_dataset}.py use what it gives.
"""
