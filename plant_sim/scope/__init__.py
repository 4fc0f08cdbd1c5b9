"""The oscilloscope of the plant: runs recorded to columnar files, and plots made from them."""
