"""Results in; what people look at out: pages, pictures, films, tables, and the files that commands write.

Pages are Jinja2 templates (`templates/`), filled in `page`; `pictures`, `grasp_pictures` and `movie` draw.
"""
