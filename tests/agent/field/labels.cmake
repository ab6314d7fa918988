# Read by ctest: every test of the room is a unit test, and can be run by the room's name. What keeps
# the field thread to itself hangs, and is ended here.
if(field_tests)
  set_tests_properties(${field_tests} PROPERTIES LABELS "unit;field" TIMEOUT 300)
endif()
