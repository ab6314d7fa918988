#include "agent/http/http_library.h"

#include <dlfcn.h>

#include <optional>

namespace fxagent {
namespace {

// The version whose header this was compiled with: Debian's libmicrohttpd12.
constexpr const char* kFile = "libmicrohttpd.so.12";

template <class Function>
bool find(void* library, const char* name, Function& function) {
  function = reinterpret_cast<Function>(::dlsym(library, name));
  return function != nullptr;
}

std::optional<HttpLibrary> load() {
  void* const library = ::dlopen(kFile, RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) return std::nullopt;
  HttpLibrary found{};
  const bool whole = find(library, "MHD_start_daemon", found.start_daemon) &&
                     find(library, "MHD_stop_daemon", found.stop_daemon) &&
                     find(library, "MHD_run", found.run) &&
                     find(library, "MHD_get_timeout", found.get_timeout) &&
                     find(library, "MHD_get_daemon_info", found.get_daemon_info) &&
                     find(library, "MHD_get_connection_info", found.get_connection_info) &&
                     find(library, "MHD_lookup_connection_value", found.lookup_connection_value) &&
                     find(library, "MHD_get_connection_values", found.get_connection_values) &&
                     find(library, "MHD_create_response_from_buffer_with_free_callback_cls",
                          found.create_response) &&
                     find(library, "MHD_add_response_header", found.add_response_header) &&
                     find(library, "MHD_queue_response", found.queue_response) &&
                     find(library, "MHD_destroy_response", found.destroy_response) &&
                     find(library, "MHD_suspend_connection", found.suspend_connection) &&
                     find(library, "MHD_resume_connection", found.resume_connection);
  return whole ? std::optional(found) : std::nullopt;
}

}  // namespace

const HttpLibrary* http_library() {
  static const std::optional<HttpLibrary> library = load();
  return library ? &*library : nullptr;
}

}  // namespace fxagent
