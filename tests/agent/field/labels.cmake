# Read by ctest. Label `threads`: tests with more than one thread, the field's own or that of the host look-up.
foreach(test IN LISTS field_tests)
  set(labels unit field)
  if(test MATCHES "^(Field|HostLookup|TcpTransport|UdpTransport|WireTrace)")
    list(APPEND labels threads)
  endif()
  set_tests_properties("${test}" PROPERTIES LABELS "${labels}")
endforeach()
