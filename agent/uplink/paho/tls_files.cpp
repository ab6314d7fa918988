#include "agent/uplink/paho/tls_files.h"

#include <openssl/err.h>
#include <openssl/ssl.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <memory>
#include <system_error>

#include "agent/config/json/tree.h"

namespace fxagent {
namespace {

/// Replaces OpenSSL's prompt on the terminal. `was_asked` points to a bool.
int no_passphrase(char*, int, int, void* was_asked) {
  *static_cast<bool*>(was_asked) = true;
  return 0;
}

/// Returns why the file cannot be read at all; empty: it can.
std::string why_unreadable(const std::string& path) {
  std::error_code fault;
  if (std::filesystem::is_directory(path, fault)) return shown(path) + ": it is a directory";
  if (::access(path.c_str(), R_OK) == 0) return {};
  return shown(path) + ": " + std::generic_category().message(errno);
}

std::string why_no_key(const std::string& path, bool has_passphrase) {
  return shown(path) + (has_passphrase
                            ? ": the key has a passphrase, which the agent cannot enter: store it "
                              "without one (openssl pkey), mode 600"
                            : ": there is no private key in PEM form in it (-----BEGIN PRIVATE "
                              "KEY-----)");
}

constexpr const char* kNoCertificate =
    ": there is no certificate in PEM form in it (-----BEGIN CERTIFICATE-----)";

std::optional<TlsFileFault> fault_in(const TlsSettings& tls, SSL_CTX* context) {
  bool was_asked = false;
  SSL_CTX_set_default_passwd_cb(context, no_passphrase);
  SSL_CTX_set_default_passwd_cb_userdata(context, &was_asked);
  if (!tls.ca_file.empty() &&
      SSL_CTX_load_verify_locations(context, tls.ca_file.c_str(), nullptr) != 1)
    return TlsFileFault{"ca_file", shown(tls.ca_file) + kNoCertificate};
  if (tls.cert_file.empty() || tls.key_file.empty()) return std::nullopt;
  if (SSL_CTX_use_certificate_chain_file(context, tls.cert_file.c_str()) != 1)
    return TlsFileFault{"cert_file", shown(tls.cert_file) + kNoCertificate};
  ERR_clear_error();
  // This call also checks that key and certificate match; only its error code shows a mismatch.
  if (SSL_CTX_use_PrivateKey_file(context, tls.key_file.c_str(), SSL_FILETYPE_PEM) == 1)
    return std::nullopt;
  const unsigned long code = ERR_peek_last_error();
  const bool is_foreign =
      ERR_GET_LIB(code) == ERR_LIB_X509 && (ERR_GET_REASON(code) == X509_R_KEY_VALUES_MISMATCH ||
                                            ERR_GET_REASON(code) == X509_R_KEY_TYPE_MISMATCH);
  return TlsFileFault{"key_file", is_foreign
                                      ? shown(tls.key_file) + ": it is not the key of cert_file " +
                                            shown(tls.cert_file)
                                      : why_no_key(tls.key_file, was_asked)};
}

}  // namespace

std::optional<TlsFileFault> fault_in(const TlsSettings& tls) {
  const std::pair<std::string_view, const std::string&> files[] = {
      {"ca_file", tls.ca_file}, {"cert_file", tls.cert_file}, {"key_file", tls.key_file}};
  for (const auto& [key, path] : files)
    if (!path.empty())
      if (std::string why = why_unreadable(path); !why.empty())
        return TlsFileFault{key, std::move(why)};
  const std::unique_ptr<SSL_CTX, decltype(&SSL_CTX_free)> context(SSL_CTX_new(TLS_client_method()),
                                                                  SSL_CTX_free);
  if (context == nullptr) return std::nullopt;  // out of memory: the handshake will report it
  auto fault = fault_in(tls, context.get());
  ERR_clear_error();
  return fault;
}

}  // namespace fxagent
