#include "agent/uplink/paho/tls_files.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

#include "tests/agent/uplink/mosquitto.h"
#include "tests/support/says.h"
#include "tests/support/scratch.h"

namespace fxagent {
namespace {

struct TlsFiles : testing::Test {
  static void SetUpTestSuite() {
    directory_ = new test::Scratch;
    test::make_certificates(*directory_, "", "DNS:localhost");
    test::make_certificates(*directory_, "other-", "DNS:localhost");
  }
  static void TearDownTestSuite() { delete directory_; }

  static std::string path(const std::string& name) { return directory_->path(name); }
  /// Returns the fault as "key: text"; empty: none.
  static std::string fault(const std::string& ca, const std::string& cert, const std::string& key) {
    const auto full = [](const std::string& name) { return name.empty() ? name : path(name); };
    const auto found = fault_in(TlsSettings{full(ca), full(cert), full(key)});
    return found ? std::string(found->key) + ": " + found->text : std::string();
  }

  static inline test::Scratch* directory_ = nullptr;
};

TEST_F(TlsFiles, ThoseThatFitEachOtherAreRight) {
  EXPECT_EQ(fault("ca.pem", "", ""), "");
  EXPECT_EQ(fault("ca.pem", "client.pem", "client.key"), "");
  EXPECT_EQ(fault("", "", ""), "");
}

TEST_F(TlsFiles, WhatIsWrongIsSaidWithKeyAndPath) {
  directory_->write("words", "no certificate");
  std::filesystem::create_directory(path("directory"));
  EXPECT_EQ(fault("none.pem", "", ""),
            "ca_file: " + path("none.pem") + ": No such file or directory");
  EXPECT_EQ(fault("directory", "", ""), "ca_file: " + path("directory") + ": it is a directory");
  EXPECT_TRUE(
      fault("words", "", "").starts_with("ca_file: " + path("words") + ": there is no cert"))
      << fault("words", "", "");
  EXPECT_TRUE(fault("ca.pem", "words", "client.key").starts_with("cert_file: " + path("words")));
  test::expect_says(fault("ca.pem", "client.pem", "words"), "there is no private key");
  EXPECT_EQ(fault("ca.pem", "client.pem", "other-client.key"),
            "key_file: " + path("other-client.key") + ": it is not the key of cert_file " +
                path("client.pem"));
}

TEST_F(TlsFiles, AKeyWithAPassphraseIsSaidToHaveOneAndNobodyIsAsked) {
  const std::string made = "openssl pkey -in " + path("client.key") +
                           " -aes128 -passout pass:x -out " + path("locked.key") + " 2>/dev/null";
  ASSERT_EQ(std::system(made.c_str()), 0);
  test::expect_says(fault("ca.pem", "client.pem", "locked.key"), "has a passphrase");
}

}  // namespace
}  // namespace fxagent
