from pdlab.page import main

main()
