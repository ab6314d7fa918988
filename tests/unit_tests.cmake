include(GoogleTest)

# Registers the tests of a program under a label; further arguments are test properties. With a sanitizer the whole
# program is one entry of ctest: a process of its own for each test took five times as long as the tests.
function(add_unit_tests target labels)
  if(FXAGENT_SANITIZE)
    add_test(NAME ${target} COMMAND ${target})
    set_tests_properties(${target} PROPERTIES LABELS "${labels}" COST 100 TIMEOUT 1200 ${ARGN})
  else()
    gtest_discover_tests(${target} PROPERTIES LABELS "${labels}" TIMEOUT 300 ${ARGN})
  endif()
endfunction()
