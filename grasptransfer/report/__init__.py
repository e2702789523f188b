"""What people are shown: pages, pictures and tables; the files that commands read and write for them."""
