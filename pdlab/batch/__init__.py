"""The runner: wishes and specimens in, results out; what is in the store is read, the rest runs on an executor.

``runner`` drives plans and writes runs, ``working`` answers wishes, ``pools`` are the executors, ``chunks`` is what a
worker does, ``jobs`` a bed on its way. Nothing is imported here: workers load ``chunks`` alone, and no database.
"""
