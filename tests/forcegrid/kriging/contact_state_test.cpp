// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/contact_state.h"

#include <gtest/gtest.h>

namespace forcegrid::kriging {
namespace {

using Eigen::Vector3d;

TEST(ContactState, IsUnknownUntilAContactIsMadeOrLost) {
  ContactState contact;
  EXPECT_FALSE(contact.known());
  contact.lost();
  EXPECT_TRUE(contact.known());
  EXPECT_FALSE(contact.in_contact());
}

TEST(ContactState, NumbersContactsAndForgetsTheOrigin) {
  ContactState contact;
  contact.made(1.5);
  EXPECT_EQ(contact.number(), 1u);
  EXPECT_EQ(contact.begun_s(), 1.5);
  contact.set_origin(Vector3d::UnitX());
  EXPECT_TRUE(contact.has_origin());
  contact.lost();
  EXPECT_TRUE(contact.has_origin()) << "late answers still refer to it";
  contact.made(2.0);
  EXPECT_EQ(contact.number(), 2u);
  EXPECT_FALSE(contact.has_origin());
}

TEST(ContactState, TellsExpectedContactsApartByPlaceAndTime) {
  ContactState contact;
  EXPECT_TRUE(contact.expect(0.0, Vector3d::Zero()));
  contact.set_origin(Vector3d::Zero());
  EXPECT_FALSE(contact.expect(0.01, Vector3d(0.001, 0.0, 0.0))) << "1 mm is the same place";
  EXPECT_TRUE(contact.expect(0.02, Vector3d(0.003, 0.0, 0.0)));
  contact.set_origin(Vector3d(0.003, 0.0, 0.0));
  EXPECT_TRUE(contact.expects(0.1));
  EXPECT_FALSE(contact.expects(0.2)) << "not repeated for more than 0.1 s";
  EXPECT_TRUE(contact.expect(0.2, Vector3d(0.003, 0.0, 0.0)));
  EXPECT_EQ(contact.number(), 3u);
  contact.made(0.25);
  EXPECT_FALSE(contact.expects(0.25));
}

}  // namespace
}  // namespace forcegrid::kriging
