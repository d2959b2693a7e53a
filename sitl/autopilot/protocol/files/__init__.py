"""MAVLink FTP: the files on board, and the server that clients read them from."""
