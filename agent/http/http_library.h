// Loads libmicrohttpd when it is first needed. Linking it would bring GnuTLS and eight more
// libraries into every process, even into an agent that serves no metrics. Any thread.
#pragma once

#include <microhttpd.h>

namespace fxagent {

/// Library functions that are used, named without MHD_.
struct HttpLibrary {
  decltype(&MHD_start_daemon) start_daemon;
  decltype(&MHD_stop_daemon) stop_daemon;
  decltype(&MHD_run) run;
  decltype(&MHD_get_timeout) get_timeout;
  decltype(&MHD_get_daemon_info) get_daemon_info;
  decltype(&MHD_get_connection_info) get_connection_info;
  decltype(&MHD_lookup_connection_value) lookup_connection_value;
  decltype(&MHD_get_connection_values) get_connection_values;
  decltype(&MHD_create_response_from_buffer_with_free_callback_cls) create_response;
  decltype(&MHD_add_response_header) add_response_header;
  decltype(&MHD_queue_response) queue_response;
  decltype(&MHD_destroy_response) destroy_response;
  decltype(&MHD_suspend_connection) suspend_connection;
  decltype(&MHD_resume_connection) resume_connection;
};

/// Returns null if the library is not installed, or not the version that this program was built
/// with. Once loaded it stays.
const HttpLibrary* http_library();

}  // namespace fxagent
