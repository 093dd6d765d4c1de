"""What every package needs: errors, command lines, files that are read and written."""
