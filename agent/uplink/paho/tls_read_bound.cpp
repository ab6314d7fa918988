#include "agent/uplink/paho/tls_read_bound.h"

#include <openssl/bio.h>
#include <openssl/ssl.h>

namespace fxagent {

TlsReadBound::TlsReadBound(SSL* connection, Counts counts) noexcept
    : bio_(SSL_get_rbio(connection)),
      limit_((counts == Counts::from_now ? BIO_number_read(bio_) : 0) + kMaxHandshake) {
  BIO_set_callback_arg(bio_, reinterpret_cast<char*>(this));
  BIO_set_callback_ex(bio_, before_read);
}

TlsReadBound::~TlsReadBound() { BIO_set_callback_ex(bio_, nullptr); }

long TlsReadBound::before_read(BIO* bio, int operation, const char*, std::size_t, int, long,
                               int ret, std::size_t*) noexcept {
  auto* const bound = reinterpret_cast<TlsReadBound*>(BIO_get_callback_arg(bio));
  if (operation != BIO_CB_READ || BIO_number_read(bio) < bound->limit_) return ret;
  bound->reached_ = true;
  BIO_clear_retry_flags(bio);
  return -1;
}

}  // namespace fxagent
