"""Video files and folders of pictures to panoramas."""
