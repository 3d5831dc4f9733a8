"""Body models in files: SMAL pickles and safetensors."""
