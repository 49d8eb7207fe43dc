"""Result files: HDF5, the view for ParaView, checkpoints."""
