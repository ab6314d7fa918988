// Whether the files of mqtt.tls are what they should be. OpenSSL would say so at the handshake, and
// in words that name neither file nor key.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "agent/config/config.h"

namespace fxagent {

struct TlsFileFault {
  std::string_view key;  ///< "ca_file", "cert_file" or "key_file"
  std::string text;      ///< what is wrong and what to do, the path in it
};

/// The first fault: a file that cannot be read, that is no PEM of its kind, or a key that does not
/// belong to the certificate. Reads all files.
std::optional<TlsFileFault> fault_in(const TlsSettings& tls);

}  // namespace fxagent
