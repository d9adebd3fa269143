"""Names of the policies, as `--policy` takes them; importing them costs nothing."""

ORACLE = "oracle"  # the expert, which knows the path and is run by the replay itself
VLM = "vlm"  # a vision-language model; the environment says where
MAP = "map"  # an online semantic map; labels are the renderer's
MAP_LLM = "map-llm"  # the same with sub-goals by a language model; the environment says where
MAP_VLM = "map-vlm"  # the same with labels by a vision-language model
MAP_VLM_LLM = "map-vlm-llm"  # both
MAPS = (MAP, MAP_LLM, MAP_VLM, MAP_VLM_LLM)
MODEL_POLICIES = (VLM, MAP_LLM, MAP_VLM, MAP_VLM_LLM)
SERVER_SCHEMES = ("ws://", "wss://")
CHECKPOINT_SUFFIX = ".safetensors"
