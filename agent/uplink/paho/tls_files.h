// Checks the files of mqtt.tls. OpenSSL would fail only at the handshake, and its texts name
// neither file nor key.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "agent/config/model.h"

namespace fxagent {

struct TlsFileFault {
  std::string_view key;  ///< "ca_file", "cert_file" or "key_file"
  std::string text;      ///< what is wrong and what to do; includes the path
};

/// Returns the first fault: a file that cannot be read, a file that is not PEM of its kind, or a
/// key that does not match the certificate. Reads the files at each call.
std::optional<TlsFileFault> fault_in(const TlsSettings& tls);

}  // namespace fxagent
