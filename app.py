from pdlab.page.app import main

main()
