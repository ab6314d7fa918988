# Read by ctest. Label `threads`: the tests that have more than one, the field's own or the host look-up's.
foreach(test IN LISTS field_tests)
  set(labels unit field)
  if(test MATCHES "^(Field|TcpTransport|UdpTransport|WireTrace)")
    list(APPEND labels threads)
  endif()
  set_tests_properties("${test}" PROPERTIES LABELS "${labels}")
endforeach()
